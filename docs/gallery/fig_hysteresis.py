"""A mass that strikes a stop, driven up and down in frequency: two jumps, and a loop between."""

from drawing import BLUE, PHANTOM, SOFT, legend, line, np, panels, vi

GAP, FORCE, ZETA, K = 0.5, 0.25, 0.05, 0.8
LOW, HIGH, STEP = 1.0, 1.6, 0.01
STOP = vi.constraint(0, {"lower": None, "upper": GAP}, K)
SYSTEM = vi.oscillator([STOP], zeta=ZETA)
DRIVE = [vi.drive(0, FORCE)]


def draw(client):
    request = vi.attractors_request(
        SYSTEM, LOW, DRIVE, initial=([0.0], [0.0]), settle=150, observe=32, section="impacts",
        points=32, outputs=["section"],
    )  # fmt: skip
    figure, ax = panels(size=(7, 3.2))
    last = branches(client, ax)
    ends = []
    ways = ((LOW, HIGH, STEP), (HIGH, LOW, -STEP))
    for (start, stop, step), marker, color, name in zip(
        ways, "^v", (BLUE, SOFT), ("swept up", "swept down"), strict=True
    ):
        axes = {"frequency.values.0": {"start": start, "stop": stop, "step": step}}
        swept = client.sweep("attractors", request, axes, continued=True)
        Omega = np.round(start + step * np.arange(swept.section_count.size), 9)
        ax.plot(
            np.repeat(Omega, swept.section_count), swept.section.velocity, marker, color=color,
            markersize=3.0, fillstyle="none", markeredgewidth=0.6, label=name,
        )  # fmt: skip
        ends.append(Omega[swept.section_count > 0].max())
    up, down = ends
    # The motion without impacts reaches the stop where its amplitude is the gap.
    squares = np.roots([1.0, 4.0 * ZETA**2 - 2.0, 1.0 - (FORCE / GAP) ** 2])
    reached = float(np.sqrt(squares.max()))
    # A step before, the transient of a step of the frequency may strike already.
    assert reached - STEP < down < reached + STEP
    assert last - STEP < up < last + STEP
    for at in ends:
        ax.axvline(at, color=PHANTOM, linewidth=0.6, linestyle=(0, (1, 2)), zorder=0)
    ax.set_xlim(LOW, HIGH)
    ax.set_ylim(0.0)
    ax.set_xlabel(r"frequency of the drive $\Omega/\Omega_0$")
    ax.set_ylabel("impact speed")
    legend(ax)
    return figure


def branches(client, ax):
    """Plot the motions with one impact in a period, and return the last frequency of a stable one.

    They follow in closed form, without sweeps.
    """
    motions = client.periodic_motions(SYSTEM, (LOW, HIGH, 601), DRIVE)
    rows, of = motions.solution, motions.impact.solution
    exists, stable = rows.exists[of], rows.stability[of] < 1.0
    Omega, speed = rows.Omega[of], motions.impact.velocity
    for shown, dash, name in (
        (exists & stable, "-", "one impact per period"),
        (exists & ~stable, (0, (3, 1.5)), "the same, unstable"),
    ):
        line(ax, Omega[shown], speed[shown], "black", name, linestyle=dash, linewidth=0.8)
    return float(Omega[exists & stable].max())
