"""YAML files, with numbers as ROS reads them."""

from __future__ import annotations

from pathlib import Path
import re

import yaml

from ctc_chattering.errors import CtcError


class Loader(yaml.SafeLoader):
    """YAML with numbers as ROS reads them: 1e-3 is one."""


Loader.add_implicit_resolver(
    'tag:yaml.org,2002:float',
    re.compile(r'^[-+]?(\d[\d_]*\.?\d*([eE][-+]?\d+)|\d[\d_]*\.\d*([eE][-+]?\d+)?|'
               r'\.\d+([eE][-+]?\d+)?|\.(inf|Inf|INF)|\.(nan|NaN|NAN))$'),
    list('-+0123456789.'))


def read_yaml(path: Path) -> object:
    """
    Return what a YAML file holds.

    Raises
    ------
    CtcError
        If it cannot be read or is not one YAML document.

    """
    try:
        with path.open(encoding='utf-8') as stream:
            return yaml.load(stream, Loader)
    except OSError as error:
        raise CtcError(f'{path}: {error.strerror or error}') from None
    except (yaml.YAMLError, ValueError) as error:
        text = ' '.join(str(error).split())
        raise CtcError(f'{path}: not a YAML file: {text}') from None
