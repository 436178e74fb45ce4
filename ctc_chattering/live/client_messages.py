# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What browsers may send: values that the widgets of the page allow, and where they look from."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Any

#: How many numbers each part of a camera has.
_CAMERA = {'wxyz': 4, 'position': 3, 'look_at': 3, 'up_direction': 3, 'fov': 1, 'near': 1,
           'far': 1, 'image_height': 1, 'image_width': 1}
#: Longest text of a field.
_CHARACTERS = 10_000


def is_allowed(message: Any, widgets: Mapping[str, Any]) -> bool:
    """
    Return whether a decoded message of a browser is one that the page itself could send.

    viser passes on to all browsers what one of them sends, and enforces no limits.

    Parameters
    ----------
    message : object
        As it was decoded.
    widgets : mapping of str to object
        The page's inputs, handles of viser, by their identifiers.

    """
    if not isinstance(message, dict):
        return False
    fields = dict(message)
    kind = fields.pop('type', None)
    if kind == 'ViewerCameraMessage':
        return fields.keys() == _CAMERA.keys() and all(
            len(x) == count and all(map(_is_number, x)) for x, count in (
                (x if isinstance(x, list) else [x], _CAMERA[name]) for name, x in fields.items()))
    if kind != 'GuiUpdateMessage' or set(fields) != {'uuid', 'updates'}:
        return False
    uuid, updates = fields['uuid'], fields['updates']
    widget = widgets.get(uuid) if isinstance(uuid, str) else None
    return (widget is not None and not widget.disabled and isinstance(updates, dict)
            and set(updates) == {'value'} and fits(widget, updates['value']))


def fits(widget: Any, value: Any) -> bool:
    """Return whether a widget can have a value: of its kind, and within its limits or options."""
    options = getattr(widget, 'options', None)
    if options is not None:
        return value in options
    now = widget.value
    if isinstance(now, bool):
        return isinstance(value, bool)
    if isinstance(now, str):
        return isinstance(value, str) and len(value) <= _CHARACTERS
    if not isinstance(now, int | float) or not _is_number(value):
        return False
    least, most = getattr(widget, 'min', None), getattr(widget, 'max', None)
    return ((least is None or value >= least) and (most is None or value <= most)
            and (isinstance(now, float) or value == int(value)))


def _is_number(value: Any) -> bool:
    try:
        return not isinstance(value, bool) and isfinite(value)
    except (TypeError, OverflowError):
        return False
