"""Assets that scenes are furnished with: textures, props, furniture, designs, panoramas, users' own files."""
