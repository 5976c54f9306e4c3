"""The craft as its log describes it: frame, motors, commands to PWM, settings of the logger."""
