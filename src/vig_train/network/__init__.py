"""The recognition network as it is trained, in torch, and its graphs."""
