"""How processes talk to each other under Fast DDS, unless the user says otherwise."""

from __future__ import annotations

import os

from ctc_chattering.share import config_directory

#: The environment variables by which Fast DDS finds a profile, in 2.x and in 3.x.
VARIABLES = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'


def use_profile(real_time: bool) -> None:
    """
    Have this process and its children use a profile of ours, if they use no other one.

    To be called before the first node is made.

    Parameters
    ----------
    real_time : bool
        Whether nobody may be held up, even at the price of smaller buffers; see
        `config/fastdds_real_time.xml`.

    """
    if not any(name in os.environ for name in VARIABLES):
        name = 'fastdds_real_time.xml' if real_time else 'fastdds.xml'
        os.environ[VARIABLES[0]] = str(config_directory() / name)
