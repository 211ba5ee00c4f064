"""ArduPilot's personalities, ArduSub and ArduRover, as their software-in-the-loop simulator shows them."""
