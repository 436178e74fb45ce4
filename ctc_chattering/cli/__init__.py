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

"""Command lines: the nodes, `bringup`, and `ctc` with its subcommands."""

import os

# A robot's matrices are too small for threads. OpenBLAS starts them nevertheless, one for each
# processor, which delays the start of every process.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
