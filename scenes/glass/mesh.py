"""Write bowl.ply: a twisted bowl with a rim, a mesh of our own making. Run it in this folder: python mesh.py"""

import struct
from math import cos, pi, sin

AROUND, ALONG = 48, 12

points, faces = [], []
for j in range(ALONG + 1):
    t = j / ALONG  # from the foot up the outside, over the rim and down the inside
    up = sin(pi * t) if t < 1 else 0.0
    radius = 0.35 + 0.65 * sin(pi * min(t, 1 - t)) - (0.08 if t > 0.5 else 0.0)
    height = 0.75 * up + (0.08 if t > 0.5 else 0.0)
    for i in range(AROUND):
        a = 2 * pi * (i / AROUND + 0.15 * height)
        r = radius * (1 + 0.04 * cos(6 * a))
        points.append((r * cos(a), r * sin(a), height))
for j in range(ALONG):
    for i in range(AROUND):
        a, b = j * AROUND + i, j * AROUND + (i + 1) % AROUND
        faces += [(a, b, b + AROUND), (a, b + AROUND, a + AROUND)]
head = f"""ply
format binary_little_endian 1.0
comment a twisted bowl, written by mesh.py
element vertex {len(points)}
property float x
property float y
property float z
element face {len(faces)}
property list uchar int vertex_index
end_header
"""
with open("bowl.ply", "wb") as file:  # noqa: PTH123
    file.write(head.encode())
    file.writelines(struct.pack("<3f", *p) for p in points)
    file.writelines(struct.pack("<B3i", 3, *f) for f in faces)
