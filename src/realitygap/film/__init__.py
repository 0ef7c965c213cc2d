"""§6 of the paper: the film from above, its camera, the disk on the robot, the tracker, the tails.

    from realitygap.film.camera import load_camera
    from realitygap.film.disk import load_disk
    from realitygap.film.tracker import track_film

    tracked = track_film("film.mp4", load_camera("camera.json"), load_disk())
    tracked.track.write_csv("track.csv")

Rooms beside this one never meet it: whoever made a film, a person or the twin, it is a file.
"""
