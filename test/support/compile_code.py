"""Compile the closed loop of two joints, which many tests would wait for."""

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.configuration import parameter_file

if __name__ == '__main__':  # Other processes compile, too, and import this.
    compile_setups([parameter_file.load(None, {'controller': values}) for values in (
        {}, {'law': 'compensation'}, {'law': 'observer_feedback'},
        {'switching': 'implicit_observer'})], print)
