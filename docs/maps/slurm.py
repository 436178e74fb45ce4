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

"""Run a map on a cluster with Slurm: `pip install dask-jobqueue`; 8 jobs of 32 processes."""

import subprocess

from dask_jobqueue import SLURMCluster

with SLURMCluster(queue='compute', account='lab', cores=32, processes=32, memory='32GB',
                  walltime='02:00:00') as cluster:
    cluster.scale(jobs=8)
    subprocess.run(['ctc', 'map', 'paper_arm', '--scheduler', cluster.scheduler_address],
                   check=True)
