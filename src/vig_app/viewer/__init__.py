"""`vig view`: a photo explained, and put right by hand, in a browser."""

from vig_app.viewer.session import Session as Session
