"""The live view: a scene that runs in real time, and a page in the browser on which a mouse leads its particles.

session.py runs the scene, messages.py checks what pages say, server.py connects them (it alone needs the extra `view`),
page/ is what the browser gets.
"""
