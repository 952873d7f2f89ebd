"""Why an image is wrong: typical mistakes are put into the tracer, and their predictions compared with the image."""
