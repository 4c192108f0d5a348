"""Fig. 10.20: period of the impacts and their intensity p as the oscillator slows down."""

from drawing import BLUE, SOFT, WALL, close, legend, line, np, panels, vi

SYSTEM = vi.oscillator([vi.constraint(0, 1.0, 0.95)])
KNOWN = {  # t: 4 lambda / Omega and p of the slow flow
    15.0: (2.1872732535542435, 3.0041936960414581),
    50.0: (4.2903582814007332, 0.50716168659038696),
    100.0: (5.5152509944315084, 0.14097459576849616),
}


def draw(client):
    figure, axes = panels(1, 2, (7, 2.8))
    for variant, color in (("printed", SOFT), ("corrected", BLUE)):
        flow = client.slow_flow(
            SYSTEM, "restitution", variant, {"omega": 5}, (0, 200, 2001),
            outputs=("state", "impulse"),
        )  # fmt: skip
        line(axes[0], flow.t, 4 / flow.omega, color, variant)
        line(axes[1], flow.t, flow.impulse, color, variant)
    axes[0].axhline(2 * np.pi, color=WALL, linewidth=0.8, label=r"$T_{nat}$")
    for ax in axes:
        ax.set_xlabel("t")
        legend(ax)
    axes[1].set_yscale("log")
    axes[0].set_ylabel(r"period of the impacts $T_{imp}$")
    axes[1].set_ylabel("impulse parameter p")
    flow = client.slow_flow(
        SYSTEM, "restitution", "corrected", {"omega": 5}, list(KNOWN), outputs=("state", "impulse")
    )
    close(4 / flow.omega, [row[0] for row in KNOWN.values()])
    close(flow.impulse, [row[1] for row in KNOWN.values()])
    return figure
