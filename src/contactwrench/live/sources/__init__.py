"""One file a device: each a `Source` (source.py), found by the scheme of its URI (uri.py)."""
