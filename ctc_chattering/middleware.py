"""How processes talk to each other under Fast DDS, unless the user says otherwise."""

from __future__ import annotations

import os

from ctc_chattering.errors import CtcError
from ctc_chattering.share import config_directory

#: The environment variables by which Fast DDS finds a profile, in 2.x and in 3.x.
VARIABLES = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'


def use_profile() -> None:
    """
    Have this process and its children use `config/fastdds.xml`, if they use no other profile.

    It does nothing where the file is not installed: the profile improves things, and nothing
    depends on it. To be called before the first node is made.
    """
    if any(name in os.environ for name in VARIABLES):
        return
    try:
        os.environ[VARIABLES[0]] = str(config_directory() / 'fastdds.xml')
    except CtcError:
        return
