"""DAVE-ML (AIAA S-119) aerodynamic models: reading, evaluating, checking and writing.

==================  ====================================================================================================
``model``           model: content of a file and evaluator; comparison with its check shots
``definition``      content of a file as plain data
``reader``          conversion of text to a definition
``elements``        XML elements with their position in the file
``writer``          conversion of a model to text
``evaluator``       computation of a model in JAX
``formulas``        formulas of computed variables
``tables``          functions given by tables
``standard_units``  units, conversion to SI, units permitted for standard variables
==================  ====================================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
