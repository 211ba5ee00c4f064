"""The planning methods: one class per family (`families.py`) and their common base (`method.py`)."""
