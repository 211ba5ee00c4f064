"""Acoustic communication: packets, slots, the bridge to the modem, drivers of modem and vehicle link."""
