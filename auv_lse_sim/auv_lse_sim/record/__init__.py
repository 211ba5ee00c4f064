"""What a mission leaves behind: recorded, written and read back."""
