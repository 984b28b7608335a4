"""The scalp of a head that has none marked, by the proportions of Hairloom's own head."""

from __future__ import annotations

import numpy as np

from ..errors import require
from ..types import Float64, Head
from .head import HeadSurface, default_head

# metres below the crown between which the tip of an adult's nose lies, and how far it may be off the middle
_NOSE_BAND = (0.10, 0.21)
_MIDDLE = 0.02
_FAR = 0.03  # metres on our own head; further apart, two heads do not correspond
_FACING = 0.3  # cosine between the normals of corresponding places


def guess_scalp(head: Head) -> Head:
    """The head with its scalp marked where Hairloom's own head, moved and scaled onto it, has its scalp.

    Crown and tip of the nose are laid on each other. head : metres, z up, face towards -y; its own scalp is not looked
    at. O(F log F).

    Raises
    ------
    InputError : nothing of the head corresponds; then its scalp must be marked by hand.
    """
    own = default_head()
    crown, nose = _crown_and_nose(head)
    own_crown, own_nose = _crown_and_nose(own)
    scale = (own_crown[2] - own_nose[2]) / (crown[2] - nose[2])
    surface, own_surface = HeadSurface(head), HeadSurface(own)
    middles = head.vertices[head.triangles].mean(axis=1, dtype=np.float64)
    on_own = (middles - [nose[0], nose[1], crown[2]]) * scale + [own_nose[0], own_nose[1], own_crown[2]]
    closest, triangle, _ = own_surface.closest_points(on_own)
    near = np.linalg.norm(closest - on_own, axis=1) < _FAR
    facing = np.einsum("nc,nc->n", surface.face_normals, own_surface.face_normals[triangle]) > _FACING
    scalp = own.scalp[triangle] & near & facing
    require(scalp.any(), "no scalp was found on the head; mark it, or turn the head's face to -y, z up, in metres")
    return Head(head.vertices, head.triangles, scalp, head.corner_uv)


def _crown_and_nose(head: Head) -> tuple[Float64, Float64]:
    """(3,) each, metres: the highest point, and the foremost one of the middle of the face."""
    vertices = head.vertices.astype(np.float64)
    crown = vertices[np.argmax(vertices[:, 2])]
    upper = vertices[vertices[:, 2] > crown[2] - _NOSE_BAND[1]]
    middle = 0.5 * (upper[:, 0].min() + upper[:, 0].max())
    depth = crown[2] - vertices[:, 2]
    face = (depth > _NOSE_BAND[0]) & (depth < _NOSE_BAND[1]) & (np.abs(vertices[:, 0] - middle) < _MIDDLE)
    require(face.any(), "no face was found 10 to 21 cm below the top of the head; is it in metres, z up?")
    return crown, vertices[face][np.argmin(vertices[face, 1])]
