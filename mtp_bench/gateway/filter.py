"""The filter of system calls: what an agent has no use for, and what lets it reach others or hoard unseen.

It is written with libseccomp, so that names become the numbers of this processor. A forbidden call fails with EPERM.
"""

from __future__ import annotations

import errno
import tempfile
from functools import cache
from typing import Any

FORBIDDEN = {
    "keys, which outlive a process": "keyctl add_key request_key",
    "other processes": (
        "ptrace process_vm_readv process_vm_writev process_madvise pidfd_getfd kcmp move_pages migrate_pages "
        "perf_event_open personality"
    ),
    "namespaces and mounts": (
        "unshare setns mount umount2 pivot_root chroot move_mount open_tree fsopen fsconfig fsmount fspick "
        "mount_setattr open_tree_attr sethostname setdomainname"
    ),
    "sockets, whose buffers no limit counts either": "socket socketpair",
    "memory that no limit counts": (
        "memfd_create memfd_secret shmget shmat msgget semget mq_open io_uring_setup io_uring_enter io_uring_register "
        "userfaultfd remap_file_pages"
    ),
    "what others read, by the page cache": (
        "mincore preadv2 cachestat fadvise64 io_setup io_submit io_pgetevents inotify_init inotify_init1 sync syncfs"
    ),
    "locks of files that others see": "flock",
    "marks on files that others see": (
        "utime utimes futimesat utimensat chown fchown lchown fchownat setxattr lsetxattr fsetxattr removexattr "
        "lremovexattr fremovexattr"
    ),
    "the kernel": (
        "bpf init_module finit_module delete_module kexec_load kexec_file_load reboot syslog acct quotactl quotactl_fd "
        "swapon swapoff "
        "fanotify_init name_to_handle_at open_by_handle_at iopl ioperm modify_ldt lookup_dcookie vhangup "
        "settimeofday clock_settime clock_adjtime adjtimex"
    ),
}
PRETENDED = "chmod fchmod fchmodat fchmodat2"  # said to have worked: copying a file ends with them
_FILE_CONTROLS = (5, 6, 7, 36, 37, 38, 1024, 1026)  # of fcntl: locks, leases, notes of changed folders
_PARENT_DEATH = 1  # of prctl: an agent must not outlive the judge
_INT = 0xFFFFFFFF  # the bits of an argument that the kernel reads of these two; a filter sees 64
_NEW_NAMESPACES = 0x7E020000  # CLONE_NEW* of clone
_NUMBERS = {"cachestat": 451, "fchmodat2": 452}  # newer than many a libseccomp; the same number on every processor


@cache
def system_call_filter() -> bytes | None:
    """The filter as a program of the kernel; None where libseccomp is not installed."""
    try:
        import pyseccomp
    except (ImportError, RuntimeError, OSError):
        return None
    rules = pyseccomp.SyscallFilter(pyseccomp.ALLOW)
    forbid = pyseccomp.ERRNO(errno.EPERM)
    for name in " ".join(FORBIDDEN.values()).split():
        _add(rules, forbid, name)
    for name in PRETENDED.split():
        _add(rules, pyseccomp.ERRNO(0), name)
    for control in _FILE_CONTROLS:
        rules.add_rule(forbid, "fcntl", pyseccomp.Arg(1, pyseccomp.MASKED_EQ, _INT, control))
    rules.add_rule(forbid, "prctl", pyseccomp.Arg(0, pyseccomp.MASKED_EQ, _INT, _PARENT_DEATH))
    # Threads are made by clone3, whose arguments a filter cannot read: without it the C library takes clone.
    rules.add_rule(pyseccomp.ERRNO(errno.ENOSYS), "clone3")
    for bit in (1 << n for n in range(32) if _NEW_NAMESPACES & (1 << n)):
        rules.add_rule(forbid, "clone", pyseccomp.Arg(0, pyseccomp.MASKED_EQ, bit, bit))
    with tempfile.TemporaryFile() as file:
        rules.export_bpf(file)
        file.seek(0)
        return file.read()


def _add(rules: Any, action: int, name: str) -> None:
    """A rule for a call by name, where this processor and this libseccomp know it."""
    import pyseccomp

    number = _NUMBERS[name] if name in _NUMBERS else pyseccomp.resolve_syscall(pyseccomp.Arch.NATIVE, name)
    if number >= 0:
        rules.add_rule(action, number)
