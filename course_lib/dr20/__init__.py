"""The DR20: a differential-drive robot that finds itself in a known map by five range rays."""
