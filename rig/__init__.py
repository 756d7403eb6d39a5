"""Real serial drivers without hardware: a virtual machine whose ports end in our hands.

``python -m rig`` (``make rig``) builds a small Debian once, boots it under QEMU's own translator
and runs ``sniffer`` in it against the kernel's drivers; see rig/README.md.
"""
