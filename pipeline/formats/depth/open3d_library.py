"""Open3D, which takes two seconds to import: functions that need it load it here."""

from __future__ import annotations

import ctypes
from functools import cache
from types import ModuleType


@cache
def load_open3d() -> ModuleType:
    """Return the module ``open3d``, quiet but for errors.

    Its CPU build links libusb without bringing it along: the package ``libusb-package`` does.
    """
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d
