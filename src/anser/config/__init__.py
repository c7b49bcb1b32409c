"""Strict TOML tables with units, error messages and JSON Schema: the base of scenario, study and aircraft files.

=======================  ===============================================================================================
``tables``               base class `Table`, and declarations of keys with unit, range and description
``errors``               `Problem` and `ScenarioError`, formatting of values, kinds of file
``validation_messages``  messages from Pydantic's validation errors, with hints for values in another unit
``toml_text``            reading and parsing of TOML text, line numbers of problems
``key_paths``            reading and replacing of values by key path
``expressions``          expressions over a flight's variables, for outputs of studies
``file_schema``          JSON Schema and tables of keys; writing of new files
``shipped_files``        scenarios, studies and aircraft files that come with anser
=======================  ===============================================================================================
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
