"""Reads area files: the operating area, no-go areas, starts and recovery positions as other programs write them."""
