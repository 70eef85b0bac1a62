"""Random scenes, states, efforts and call orders, and what must hold for all of them."""
