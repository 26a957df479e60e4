"""Elements on top of the picture: a script in the page and its Python side."""
