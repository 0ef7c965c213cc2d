"""§6 of the paper: the film from above, its camera, the disk on the robot, the tracker, the tails.

    from realitygap.film.camera import load_camera
    from realitygap.film.disk import load_disk
    from realitygap.film.tracker import track_film

    tracked = track_film("film.mp4", load_camera("camera.json"), load_disk())
    tracked.track.write_csv("track.csv")

Whoever made a film, a person or the twin, it is a file.
"""

from realitygap.lazy import names_of

__all__, __getattr__ = names_of(__name__, {
    "calibrate": "calibrate_camera",
    "camera": "CameraModel load_camera",
    "disk": "Disk load_disk",
    "live": "LiveCamera",
    "printed": "draw_tails save_sheet save_tails",
    "tracker": "Tracked Tracker track_film",
    "video": "FilmReader FilmWriter",
})  # fmt: skip
