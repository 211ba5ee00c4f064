"""The link to a MAVLink autopilot: messages, frames and units, mission upload, soundings."""
