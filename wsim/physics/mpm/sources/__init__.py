"""What pours in and what sinks take."""
