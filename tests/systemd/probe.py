"""Run in the place of servotwind, with all the restrictions of its unit: what must work, and what must not."""

import errno
import os
import socket


def refused(action, *numbers):
    try:
        action()
    except OSError as error:
        if error.errno in numbers:
            return True
        print("unexpected:", error)
    return False


def check(text, good):
    print("ok " if good else "FAILED ", text, sep="", flush=True)


can = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
can.bind(("vcan0",))
check("CAN can be sent", can.send(bytes(16)) == 16)
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(80))
check("SCHED_FIFO 80 is permitted", os.sched_getscheduler(0) == os.SCHED_FIFO)
state = os.environ["STATE_DIRECTORY"]
with open(os.path.join(state, "probe"), "w") as file:
    file.write("x")
check("the state directory can be written", True)
check("packet sockets are refused", refused(lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW), errno.EAFNOSUPPORT))
check("/etc is read-only", refused(lambda: open("/etc/servotwin/probe", "w"), errno.EROFS))
check("it is not root", os.getuid() != 0)
check("it has no capability", "CapEff:\t0000000000000000" in open("/proc/self/status").read())
check("the clock cannot be set", refused(lambda: __import__("time").clock_settime(0, 0), errno.EPERM))

udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
check("this host can be reached", udp.sendto(b"x", ("127.0.0.1", 9)) == 1)
check("other addresses cannot", refused(lambda: udp.sendto(b"x", ("192.0.2.1", 9)), errno.EPERM))
