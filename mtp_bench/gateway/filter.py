"""The filter of system calls: what an agent has no use for, and what lets it reach others or hoard unseen.

It is written with libseccomp, so that names become the numbers of this processor. A forbidden call fails with EPERM.
"""

from __future__ import annotations

import errno
import tempfile
from functools import cache

FORBIDDEN = {
    "keys, which outlive a process": "keyctl add_key request_key",
    "other processes": (
        "ptrace process_vm_readv process_vm_writev process_madvise pidfd_getfd kcmp move_pages migrate_pages "
        "perf_event_open"
    ),
    "namespaces and mounts": (
        "unshare setns mount umount2 pivot_root chroot move_mount open_tree fsopen fsconfig fsmount fspick "
        "mount_setattr sethostname setdomainname"
    ),
    "sockets": "socket",
    "memory that no limit counts": (
        "memfd_create memfd_secret shmget shmat msgget semget mq_open io_uring_setup io_uring_enter io_uring_register "
        "userfaultfd remap_file_pages"
    ),
    "what others read, by the page cache": "mincore preadv2 cachestat fadvise64 inotify_init inotify_init1",
    "the kernel": (
        "bpf init_module finit_module delete_module kexec_load kexec_file_load reboot syslog acct quotactl swapon "
        "swapoff fanotify_init name_to_handle_at open_by_handle_at iopl ioperm modify_ldt lookup_dcookie vhangup "
        "settimeofday clock_settime clock_adjtime adjtimex"
    ),
}
_NEW_NAMESPACES = 0x7E020000  # CLONE_NEW* of clone
_NUMBERS = {"cachestat": 451}  # newer than many a libseccomp; the same number on every processor


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
        number = pyseccomp.resolve_syscall(pyseccomp.Arch.NATIVE, name) if name not in _NUMBERS else _NUMBERS[name]
        if number >= 0:  # some processors lack some calls
            rules.add_rule(forbid, number)
    # Threads are made by clone3, whose arguments a filter cannot read: without it the C library takes clone.
    rules.add_rule(pyseccomp.ERRNO(errno.ENOSYS), "clone3")
    for bit in (1 << n for n in range(32) if _NEW_NAMESPACES & (1 << n)):
        rules.add_rule(forbid, "clone", pyseccomp.Arg(0, pyseccomp.MASKED_EQ, bit, bit))
    with tempfile.TemporaryFile() as file:
        rules.export_bpf(file)
        file.seek(0)
        return file.read()
