"""The 252-byte packet: its fields, its bytes, which samples it carries, its authentication tag."""
