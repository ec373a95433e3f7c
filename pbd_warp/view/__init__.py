"""The live view: a scene that runs in real time, and a page in the browser on which a mouse drags its particles.

session.py runs the scene (history.py: what it keeps, changes.py: how it is changed); messages.py checks what pages say,
report.py is what they are told, turn.py does both in the simulating thread; server.py connects them (access.py: who
may, connection.py: one page, saving.py: files); page/ is what the browser gets.
"""
