"""PX4 logs (.ulg), through pyulog."""
