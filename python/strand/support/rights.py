"""Give a new file the owner, the group, the mode and the extended attributes of the file that it replaces."""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from pathlib import Path

_ACCESS_LIST = "system.posix_acl_access"
_GROUP_BITS = 0o070


def copy_rights(old: Path, new: int) -> None:
    """Give an open file what the system allows of an existing file's rights.

    A group that cannot be kept gives its bits of the mode to nobody: the new group may do what others may.
    Nothing is copied from a file that is missing, and nothing on Windows, where folders give the rights.
    """
    if not hasattr(os, "chown"):
        return
    try:
        was = os.stat(old)
    except FileNotFoundError:
        return
    for owner, group in ((-1, was.st_gid), (was.st_uid, -1)):
        with suppress(OSError):  # of another user or group, or a file system without owners
            os.chown(new, owner, group)
    now, mode = os.fstat(new), stat.S_IMODE(was.st_mode)
    if now.st_uid != was.st_uid:
        mode &= ~stat.S_ISUID
    kept_group = now.st_gid == was.st_gid
    if not kept_group:
        mode = (mode & ~(stat.S_ISGID | _GROUP_BITS)) | (mode & 0o007) << 3
    with suppress(OSError):
        os.chmod(new, mode)
    if hasattr(os, "listxattr"):
        _copy_attributes(old, new, kept_group)


def _copy_attributes(old: Path, new: int, kept_group: bool) -> None:
    """Copy extended attributes; an access list is one, and the folder may have given the new file another."""
    try:
        names = set(os.listxattr(old))
        if not kept_group:
            names.discard(_ACCESS_LIST)
        if _ACCESS_LIST in set(os.listxattr(new)) - names:
            os.removexattr(new, _ACCESS_LIST)
    except OSError:  # a file system without attributes
        return
    for name in names:
        with suppress(OSError):  # of the system alone, or too large for this file system
            os.setxattr(new, name, os.getxattr(old, name))
