"""One module for each group of claims: its checks, and the figures and tables beside them."""

from importlib import import_module
from pkgutil import iter_modules

for _module in iter_modules(__path__, f"{__name__}."):
    import_module(_module.name)  # it registers its checks
