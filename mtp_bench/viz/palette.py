"""Colours that are distinct in every kind of colour vision (Okabe and Ito)."""

Color = tuple[int, int, int]  # red, green, blue, 0 to 255

BLACK = (0, 0, 0)
ORANGE = (230, 159, 0)
SKY = (86, 180, 233)
GREEN = (0, 158, 115)
YELLOW = (240, 228, 66)
BLUE = (0, 114, 178)
VERMILLION = (213, 94, 0)
PURPLE = (204, 121, 167)

TRUTH = GREEN
DETECTION = ORANGE
TRACK = BLUE
OTHER_TRACK = SKY  # of another hypothesis than the best
FORECAST = PURPLE
FALSE = VERMILLION  # a false track, detection or forecast
EVENT = YELLOW
EGO = BLACK

# an event alone: its own parts are bright, all others dim
BEFORE_EVENT = BLUE  # the track and the forecast before the event
FROM_EVENT = VERMILLION  # those from the event on
DIM = (190, 190, 190)
ROLES = {  # role of a thing in the event -> its colour
    "truth": TRUTH,
    "before": BEFORE_EVENT,
    "now": FROM_EVENT,
    "detection": BLACK,
    "named": PURPLE,
}
