"""An identified craft for other programs: simulator frame, linear hover model, files."""
