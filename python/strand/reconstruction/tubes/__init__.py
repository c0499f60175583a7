"""The default method: tubes traced through oriented points and fitted together with the poses."""
