from PIL import ImageCms

from raytwin.photos.augment import of_three_channels


def test_a_grey_photos_profile_is_not_kept_and_all_else_is():
    """The data colour space is at bytes 16 to 19 of a profile (ICC.1, 7.2)."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    extras = {"icc_profile": srgb, "exif": b"Exif\0\0 and more"}
    assert of_three_channels(extras) == extras
    assert of_three_channels(extras | {"icc_profile": srgb[:16] + b"GRAY" + srgb[20:]}) == {"exif": extras["exif"]}
    assert of_three_channels({}) == {}
