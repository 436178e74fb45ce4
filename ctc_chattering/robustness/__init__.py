"""Maps of the laws over grids and draws of parameters, and gains tuned for them."""
