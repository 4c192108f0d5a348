"""A service like that of ``vibroimpact serve``, whose workers note what they do.

Kernels that are not there are compiled where they are needed first; with ``WARMS`` beforehand.
"""

from __future__ import annotations

import os
from contextlib import nullcontext

from vibroimpact_service import use_case
from vibroimpact_service.jobs import forkserver
from vibroimpact_service.settings import Settings


def main() -> None:
    settings = Settings()
    if settings.scheduler is None:
        forkserver.start((*use_case.NUMERICAL, "recording"))
    import recording

    from vibroimpact_service.app import create_app
    from vibroimpact_service.cli import Server
    from vibroimpact_service.jobs.queue import JobQueue
    from vibroimpact_service.store import Store
    from vibroimpact_service.use_case.warming import Warming

    queue = JobQueue(settings, Store(settings.store_url, patient=False), recording.WORK)
    warming = Warming()
    with warming.in_background() if "WARMS" in os.environ else nullcontext():
        Server(create_app(settings, queue, warming), settings).run()


if __name__ == "__main__":
    main()
