"""Where poses come from: the datagram format of the camera's reader process, and the sources that yield `Pose`."""
