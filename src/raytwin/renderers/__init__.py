"""Every way to make an image, a small frozen record a kind: `method(scene, seed) -> Image`."""
