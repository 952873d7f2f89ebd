"""Photos of a board to a calibrated camera; synthetic photos; spheres drawn into photos."""
