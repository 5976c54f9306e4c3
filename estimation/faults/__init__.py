"""What is wrong with a sensor, found before and while it is fused: compass, receiver, barometer, blows to the IMU."""
