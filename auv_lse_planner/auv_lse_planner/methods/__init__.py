"""The planning methods: a class for each family (`families.py`), and what they have in common (`method.py`)."""
