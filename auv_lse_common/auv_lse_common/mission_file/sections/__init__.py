"""The sections of the mission file, a dataclass each."""
