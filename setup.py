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

"""Package for colcon (`ament_python`) and pip alike."""

from pathlib import Path
import re

from setuptools import find_packages, setup
from setuptools.command.develop import develop

NAME = 'ctc_chattering'
README = Path(__file__).resolve().with_name('README.md')


def files(directory):
    """Return the files of a directory, without those below it."""
    return sorted(str(path) for path in Path(directory).iterdir() if path.is_file())


class Develop(develop):
    """What `colcon build --symlink-install` runs; it ignores [build_scripts]."""

    def write_script(self, script_name, contents, *mode):
        """Write a script that runs under the Python of the environment it is called in."""
        contents = re.sub(r'\A#!.*', '#!/usr/bin/env python3', contents)
        super().write_script(script_name, contents, *mode)


setup(
    name=NAME,
    cmdclass={'develop': Develop},
    version='1.0.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['py.typed', '__init__.pyi'],
                  '': ['*.html', 'templates/*', 'templates/*/*', 'web/*']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml', 'LICENSE']),
        (f'share/{NAME}/config', files('config')),
        (f'share/{NAME}/config/cases', files('config/cases')),
        (f'share/{NAME}/config/trajectories', files('config/trajectories')),
        (f'share/{NAME}/config/maps', files('config/maps')),
        (f'share/{NAME}/launch', files('launch')),
    ],
    python_requires='>=3.10',
    install_requires=[
        'setuptools', 'jinja2', 'lz4', 'matplotlib', 'mcap>=1.6', 'numpy', 'PyYAML',
        'rosbags>=0.11', 'scipy', 'tqdm', 'zstandard'],
    extras_require={
        # An apt installation of ROS 2 has these without distributions of these names.
        'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
        # The page of `ctc live`.
        'live': ['msgspec', 'viser>=1.1'],
        # The model urdf, of apt ros-jazzy-pinocchio; the robots of panda.yaml and ur5.yaml.
        'urdf': ['example-robot-data', 'pin'],
        # `ctc compile`.
        'compile': ['numba'],
        # `ctc map`, `ctc compare`, several processes of the others; without numba they are slow.
        'map': ['numba', 'dask[distributed]', 'pandas>=2', 'pyarrow', 'scipy>=1.15'],
        # `ctc tune`.
        'tune': ['optuna>=5', 'pandas>=2', 'pyarrow', 'scipy>=1.15'],
        # Everything above.
        'all': ['ctc_chattering[compile,live,map,ros,tune,urdf]'],
        'test': ['dask[distributed]', 'example-robot-data', 'hypothesis', 'mujoco',
                 'numba', 'optuna>=5', 'pandas>=2', 'pin', 'playwright', 'polars', 'pyarrow',
                 'pytest', 'pytest-xdist', 'scipy>=1.15', 'viser>=1.1'],
        # The site of `make docs`.
        'docs': ['furo', 'myst-parser', 'sphinx>=7.2'],
        # The plugins that ament_flake8 of jazzy has.
        'lint': ['flake8', 'flake8-blind-except', 'flake8-builtins', 'flake8-class-newline',
                 'flake8-comprehensions', 'flake8-deprecated', 'flake8-docstrings',
                 'flake8-import-order', 'flake8-quotes', 'mypy', 'pydocstyle', 'ruff',
                 'types-PyYAML'],
    },
    zip_safe=True,
    author='ctc_chattering maintainers',
    maintainer='ctc_chattering maintainers',
    maintainer_email='maintainers@users.noreply.github.com',
    description='Computed torque plus compensation plus chattering for robot arms with friction',
    long_description=README.read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    license='Apache-2.0',
    url='https://example.org/ctc_chattering',
    classifiers=[
        'Environment :: Console', 'Intended Audience :: Science/Research',
        'Operating System :: POSIX :: Linux', 'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering'],
    entry_points={
        'console_scripts': [
            'plant = ctc_chattering.cli.node:plant',
            'controller = ctc_chattering.cli.node:controller',
            'reference = ctc_chattering.cli.node:reference',
            'recorder = ctc_chattering.cli.node:recorder',
            'bringup = ctc_chattering.cli.bringup:main',
            'ctc = ctc_chattering.cli.ctc:main',
        ],
    },
)
