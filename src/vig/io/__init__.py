"""Files, checks of what others wrote, and the errors that users see."""
