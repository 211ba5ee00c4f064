"""The topics of a mission, their quality of service, and conversions of their messages."""
