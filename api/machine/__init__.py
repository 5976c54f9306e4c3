"""What programs and assistants ask, over HTTP and the Model Context Protocol."""
