"""The decentralised planner: each aircraft plans for itself, and the fleet agrees by messages.

``planner`` is the planner in the loop, ``path_exchange`` the agreement on paths, ``time_coordination`` the common
progress along the paths, ``network`` the radio links and messages.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
