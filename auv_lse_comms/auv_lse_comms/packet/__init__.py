"""The 252-byte packet: its fields, codec, selection of samples, and authentication tag."""
