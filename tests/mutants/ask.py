"""One run of the tests, by the process of `tests.mutants.warm` that has imported the libraries already: its exit code.

Run with `python -IS`: it needs nothing but a socket, and there are thousands of runs.
"""

import socket
import sys

with socket.socket(socket.AF_UNIX) as server:
    server.connect(sys.argv[1])
    answer = server.recv(1)
sys.exit(answer[0] if answer else 1)
