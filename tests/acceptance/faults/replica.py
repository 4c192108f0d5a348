"""A service like that of ``vibroimpact serve``, whose workers note what they do."""

from __future__ import annotations

from vibroimpact_service import loading
from vibroimpact_service.jobs import forkserver
from vibroimpact_service.settings import Settings


def main() -> None:
    settings = Settings()
    if settings.scheduler is None:
        forkserver.start((*loading.NUMERICAL, "recording"))
    import recording

    from vibroimpact_service.app import create_app
    from vibroimpact_service.cli import Server
    from vibroimpact_service.jobs.queue import JobQueue
    from vibroimpact_service.store import Store

    queue = JobQueue(settings, Store(settings.store_url), recording.WORK)
    Server(create_app(settings, queue), settings).run()


if __name__ == "__main__":
    main()
