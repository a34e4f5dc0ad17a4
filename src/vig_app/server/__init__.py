"""`vig serve`: photos explained over HTTP, and pre-annotations for Label Studio."""
