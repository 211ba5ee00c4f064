"""Parsing that several log formats share: text encodings, times, NMEA sentences, tables."""
