"""Class packs built from the generator's designs."""
