"""Files, checks of input, and the errors that users see."""
