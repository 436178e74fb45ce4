"""A page that shows the arm and the law, of a running graph or of bags, and exports of it."""
