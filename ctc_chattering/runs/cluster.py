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

"""
Runs on a dask cluster, which is not trusted.

`map.complete_table` comes here with ``ctc map --scheduler``. Workers answer with the bytes of a
table, as Arrow writes it. Dask itself would also unpickle an answer, an error or a message of the
scheduler, and that can run any program. While this process is connected, an audit hook of Python
refuses it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from functools import cache
import sys
import threading
from typing import Any, TYPE_CHECKING

from ctc_chattering.errors import as_ctc_error, CtcError
from ctc_chattering.runs import pool, store
from ctc_chattering.runs.run_lists import RunList
from ctc_chattering.runs.store import Numbers
import numpy as np
import pyarrow

if TYPE_CHECKING:
    from distributed import Client

#: Key of a table's metadata with the reason why a worker computed no rows.
_REFUSAL = b'refusal'
#: Class that dask unpickles for an answer of bytes.
_BYTES = ('builtins', 'bytes')
#: Threads that have connected this process. Nothing from the network is unpickled in them.
_CONNECTING: list[int] = []


@contextmanager
def connect_cluster(address: str) -> Iterator[Client]:
    """
    Yield a client of a cluster.

    Other threads of this process unpickle nothing until the context ends.

    Parameters
    ----------
    address : str
        Address of the scheduler, ``tcp://host:port``.

    Raises
    ------
    CtcError
        If there is no scheduler at the address.

    """
    import distributed  # noqa: F401 - It unpickles its own objects during the import.
    _watch()
    _CONNECTING.append(threading.get_ident())
    try:
        with pool.workers(1, address) as client:
            yield client
    finally:
        _CONNECTING.pop()


@cache
def _watch() -> None:
    """Have Python call `_refuse` before it unpickles a class."""
    sys.addaudithook(_refuse)


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """Raise `TypeError`, which dask expects, for a harmful class."""
    if (event == 'pickle.find_class' and _CONNECTING and arguments != _BYTES
            and threading.get_ident() not in _CONNECTING):
        raise TypeError(f'{".".join(map(str, arguments))} was sent to be unpickled, which is '
                        'refused')


def run_on_cluster(client: Client, runs: RunList, chunks: Collection[Numbers]
                   ) -> Iterator[pyarrow.Table]:
    """
    Yield the rows of every chunk, in their order.

    Parameters
    ----------
    client : Client
        Client that `connect_cluster` yields.
    runs : RunList
        All runs.
    chunks : collection of sequence of int
        Numbers of the runs of each chunk.

    Raises
    ------
    CtcError
        If a worker refuses a chunk, or answers with anything else than its rows. If workers fail,
        or the scheduler is lost.

    """
    columns = store.table_schema(runs)
    answers = pool.run_on_workers(client, answer, chunks, runs, store.version())
    for chunk in chunks:
        try:
            data = next(answers)
        except CtcError as error:
            if any(isinstance(x, bytes) for x in getattr(error.__cause__, 'args', ())):
                # An error that was not unpickled is dask's own, since `answer` raises none.
                raise CtcError('a worker failed: it was killed again and again over one chunk (is '
                               'there enough memory?), or cannot load ctc_chattering; its log '
                               'says why') from None
            raise
        yield read_answer(data, columns, chunk)


def answer(runs: RunList, version: str, chunk: Numbers) -> bytes:
    """Return the rows of a chunk, or a refusal, as bytes."""
    try:
        with as_ctc_error('a worker failed'):
            table = store.compute(runs, version, chunk)
    except CtcError as error:
        table = pyarrow.schema([], {_REFUSAL: str(error)}).empty_table()
    return to_bytes(table)


def to_bytes(table: pyarrow.Table) -> bytes:
    """Return a table as Arrow sends it."""
    sink = pyarrow.BufferOutputStream()
    with pyarrow.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return bytes(sink.getvalue())


def read_answer(data: object, columns: pyarrow.Schema, chunk: Numbers) -> pyarrow.Table:
    """
    Return the rows of an answer.

    Parameters
    ----------
    data : object
        Answer of a worker.
    columns : pyarrow.Schema
        Columns of the rows.
    chunk : sequence of int
        Numbers of their runs.

    Raises
    ------
    CtcError
        With the reason of the worker, or if these are not the rows of the chunk.

    """
    if not isinstance(data, bytes):
        raise CtcError(f'a worker answered with {type(data).__name__}, not with a table')
    try:
        table = pyarrow.ipc.open_stream(data).read_all()
        table.validate(full=True)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise CtcError('a worker answered with what is no table: '
                       + ' '.join(str(error).split())) from None
    refusal = (table.schema.metadata or {}).get(_REFUSAL)
    if refusal is not None:
        raise CtcError(''.join(x for x in refusal.decode('utf-8', 'replace') if x.isprintable()))
    if not table.schema.equals(columns) or not np.array_equal(table['run'], chunk):
        raise CtcError('a worker answered with other rows or columns than it was asked for')
    return table
