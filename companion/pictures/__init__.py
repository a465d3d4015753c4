"""Drawings by matplotlib, one module for each kind; the command line asks for them.

Results come in, files go out; nothing is computed here that a number elsewhere depends on, and nothing of the service
imports this.
"""
