#!/bin/sh
# The quick way up: udev and the agent, no systemd. Kernel command line: rig.init=/opt/init
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
mount -t proc proc /proc
mount -t sysfs sysfs /sys
mount -t devtmpfs dev /dev
mkdir -p /dev/pts /dev/shm
mount -t devpts -o mode=620,gid=5 pts /dev/pts
for at in /run /tmp /dev/shm; do mount -t tmpfs tmp $at; done
hostname rig
modprobe -a virtio_console 9pnet_virtio 9p
mount -t 9p -o trans=virtio,version=9p2000.L,ro,cache=loose,msize=262144 src /src
/lib/systemd/systemd-udevd --daemon
udevadm trigger --action=add --subsystem-match=virtio-ports --subsystem-match=tty
(modprobe xhci_pci; udevadm settle) &
/opt/sniffer/bin/python3 -u /src/rig/guest/agent.py
exec sleep 1000000
