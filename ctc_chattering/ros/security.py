"""SROS 2: what ROS would say at length, or not at all, said at once."""

from __future__ import annotations

import os
from pathlib import Path

from ctc_chattering.errors import CtcError


def check_security() -> None:
    """
    Refuse to go on where security is enforced and there is no keystore.

    Raises
    ------
    CtcError
        If it is so.

    """
    if (os.environ.get('ROS_SECURITY_ENABLE') != 'true'
            or os.environ.get('ROS_SECURITY_STRATEGY') != 'Enforce'):
        return
    keystore = os.environ.get('ROS_SECURITY_KEYSTORE')
    if not keystore:
        raise CtcError('ROS_SECURITY_STRATEGY is Enforce, but ROS_SECURITY_KEYSTORE is not set')
    if not Path(keystore, 'enclaves').is_dir():
        raise CtcError(f'ROS_SECURITY_STRATEGY is Enforce, but ROS_SECURITY_KEYSTORE={keystore} '
                       'is no keystore: it holds no directory enclaves')
