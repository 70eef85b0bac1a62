"""The colours of all pictures, (red, green, blue) from 0 to 255."""

Color = tuple[int, int, int]

BACKGROUND = (250, 250, 248)
JOINT = (28, 36, 52)  # also of masses and of the names of coordinates
INK, SOFT, FAINT = (74, 84, 104), (107, 115, 132), (160, 166, 178)  # of texts, from the strongest on
LINKS = ((52, 73, 110), (86, 118, 168), (124, 157, 205), (168, 192, 226))  # from the base on
ARMS = (
    (LINKS[0], LINKS[2]), ((181, 84, 28), (229, 160, 111)), ((46, 125, 91), (134, 195, 166)),
    ((122, 75, 148), (189, 155, 208)),
)  # fmt: skip
"""Of links and sliders, where several arms are in a picture."""
RAIL = (198, 204, 214)
TRAIL = (240, 140, 60)
GOAL = (46, 160, 103)
REACH = (228, 231, 236)
OBSTACLE, EDGE = (241, 236, 227), (176, 164, 146)
CABLE, SLACK = (150, 74, 130), (214, 184, 206)
FORCE, READING = (196, 52, 104), (110, 168, 160)
LOAD, WAITING = (122, 84, 62), (190, 168, 152)
GRID = (216, 219, 224)
BAR_TRACK, BAR_PLUS, BAR_MINUS = (226, 229, 234), (70, 120, 190), (205, 92, 92)
KINETIC, POTENTIAL, TOTAL = LINKS[0], (217, 130, 43), (46, 139, 102)  # of energies
ERROR, LEFT_OUT = (140, 59, 59), (169, 173, 181)

# Of figures: Okabe and Ito's colours, which colour-blind readers can tell apart, and greys.
BLUE, VERMILION, GREEN, PINK = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
AMBER, SKY, BROWN, GREY, DARK = "#E69F00", "#56B4E9", "#8C564B", "#999999", "#222222"
LEARNERS = {
    "PPO": BLUE, "SAC": VERMILION, "HER": GREEN, "CrossQ": PINK, "TD3": AMBER, "TQC": SKY,
    "stock PPO": GREY, "stock SAC": BROWN,
}  # fmt: skip
EXPERT = "black"  # and computed torque
ROBOTS = {"4R": BLUE, "RPRP": GREEN, "2R": GREY}


def css(color: Color) -> str:
    """A colour as SVG and matplotlib take it, such as "#fafaf8"."""
    return "#{:02x}{:02x}{:02x}".format(*color)
