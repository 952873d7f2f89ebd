"""Files in and out, and all validation of them.

Reading: TOML into records, scenes, photos, EXR, any image (`read_image`). Writing: always under a temporary name first.
"""

from raytwin.files.cache import cache_folder, installed, made_by
from raytwin.files.exr import read_exr, split_layer, write_exr
from raytwin.files.images import kind_of, read_image, write_image
from raytwin.files.limits import MAX_PIXELS
from raytwin.files.mitsuba_file import (
    ALLOW,
    allowed,
    as_loaded,
    is_mitsuba,
    mitsuba_plugins,
    read_mitsuba,
    with_film,
    write_mitsuba,
)
from raytwin.files.photo_files import (
    data_url,
    encoded,
    from_bytes,
    list_photos,
    photo_extras,
    photo_orientation,
    photo_size,
    read_grey,
    read_photo,
    readable_photos,
    srgb_decode,
    srgb_encode,
    to_bytes,
    write_picture,
)
from raytwin.files.rounding import DITHERED, Rounding, half_floats, rounding_of
from raytwin.files.safe_write import check_file, replacing, replacing_files, write_text
from raytwin.files.scene_files import (
    check_camera,
    check_contents,
    read_camera,
    read_scene,
    read_sky_map,
    scene_and_photos,
    scene_name,
    scene_text,
    write_camera,
    write_scene,
)
from raytwin.files.toml_json import json_text, plain, read_toml, to_record, unknown_key, write_json, write_toml
from raytwin.scene_folders import (
    REFERENCES,
    SCENES,
    all_scenes,
    copy_scene,
    find_scene,
    scenes,
)
