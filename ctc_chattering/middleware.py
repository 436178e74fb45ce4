"""How processes talk to each other under Fast DDS, unless the user says otherwise."""

from __future__ import annotations

import os

from ctc_chattering.share import config_directory

#: The environment variables by which Fast DDS finds a profile, in 2.x and in 3.x.
VARIABLES = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'


def use_profile() -> None:
    """
    Have this process and its children use `config/fastdds.xml`, if they use no other profile.

    To be called before the first node is made.
    """
    if not any(name in os.environ for name in VARIABLES):
        os.environ[VARIABLES[0]] = str(config_directory() / 'fastdds.xml')
