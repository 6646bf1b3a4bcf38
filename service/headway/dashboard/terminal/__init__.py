"""`headway watch`: the page for a terminal."""
