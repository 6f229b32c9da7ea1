"""One line for every user error: what, where and how to fix it."""

from __future__ import annotations

import errno

from .._types import UserError, printable

_FIX = {
    errno.ENOSPC: "free some space, or choose another place with --out",
    errno.EDQUOT: "your quota is used up: free some space, or choose another place with --out",
    errno.EFBIG: "the file system takes no file this large: choose another place with --out",
    errno.EACCES: "change its permissions, or choose another place",
    errno.EPERM: "change its permissions, or choose another place",
    errno.EROFS: "choose a place that can be written to",
    errno.ENOENT: "check the path",
    errno.ENOTDIR: "a part of this path is a file: check the path",
    errno.EISDIR: "this is a folder: name a file",
    errno.EEXIST: "choose another name",
    errno.ENOTEMPTY: "empty the folder, or choose another name",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.EIO: "the disk cannot be read: try a copy on another one",
    errno.EMFILE: "too many files are open: raise the limit with ulimit -n",
}


def explain(error: UserError | OSError) -> str:
    """The message of a user's mistake, on one line."""
    message = _explain_os_error(error) if isinstance(error, OSError) else str(error)
    return printable(" ".join(message.split()))


def _explain_os_error(error: OSError) -> str:
    if error.errno is None:
        return str(error) or type(error).__name__
    where = error.filename if error.filename is not None else "a file"
    if isinstance(where, bytes):
        where = where.decode(errors="replace")
    return f"{where}: {error.strerror}; {_FIX.get(error.errno, 'check the path and try again')}"
