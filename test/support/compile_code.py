"""Compile the closed loop of two joints and the plant with faults, for which tests would wait."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.configuration import parameter_file


def compile_plant() -> None:
    """Compile the plant with the faults of real arms."""
    from faulty_robots import plain, Plant, record

    record('two_link_urdf', 0, 0.1)
    Plant(plain('two_link_urdf', 0), (0.0, 0.0)).step((0.0, 0.0))


if __name__ == '__main__':  # Other processes compile, too, and import this.
    with ProcessPoolExecutor(1, get_context('spawn')) as pool:
        plant = pool.submit(compile_plant)
        compile_setups([parameter_file.load(None, {'controller': values}) for values in (
            {}, {'law': 'compensation'}, {'law': 'observer_feedback'},
            {'switching': 'implicit_observer'})], print)
        plant.result()
