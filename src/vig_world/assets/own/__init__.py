"""Custom panoramas, props and furniture, read from folders of HDR and mesh files."""
