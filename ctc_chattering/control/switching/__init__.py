"""The ways to evaluate the chattering term of law (6), Ka sgn(v), one a module."""

#: Values of the parameter ``switching``, besides classes.
SWITCHINGS = ('sign', 'boundary_layer', 'implicit', 'implicit_observer')
