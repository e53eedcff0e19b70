"""A node of ROS 2 without ROS: the wire of rmw_zenoh (keys, tokens, attachments, type hashes), CDR by `rosbags`.

``wire``, ``definitions`` and ``type_hash`` are pure; ``interfaces`` reads files; ``session`` and ``node`` speak Zenoh.
"""
