from small_recordings import base, chain, takes  # noqa: F401 - fixtures
