"""Requests that are ready at the same moment begin a few at a time, in their order."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from prometheus_client import CollectorRegistry
from starlette.types import Message, Receive, Scope, Send

from vibroimpact_service.api.boundary import Boundary, Pacing
from vibroimpact_service.metrics import Metrics


async def nothing() -> Message:
    return {"type": "http.request", "body": b"", "more_body": False}


async def nowhere(message: Message) -> None:
    """Take an answer."""


class Begun:
    """An application that notes who began, and in which turn of the loop."""

    def __init__(self) -> None:
        self.turn = 0
        self.found: list[tuple[int, int]] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.found.append((self.turn, scope["number"]))

    async def count(self) -> None:
        while True:
            self.turn += 1
            await asyncio.sleep(0)


class Paced:
    """An application whose requests wait for their turn."""

    def __init__(self, app: Begun, at_once: int) -> None:
        self._app, self._pacing = app, Pacing(at_once)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        await self._pacing.begin()
        await self._app(scope, receive, send)


def in_a_loop(scenario: Callable[[Begun, Paced], Awaitable[None]], at_once: int = 4) -> Begun:
    app = Begun()

    async def main() -> None:
        counting = asyncio.create_task(app.count())
        await asyncio.sleep(0)
        await scenario(app, Paced(app, at_once))
        counting.cancel()

    asyncio.run(main())
    return app


def ask(paced: Paced, number: int, kind: str = "http") -> asyncio.Task[None]:
    async def one() -> None:
        await paced({"type": kind, "number": number}, nothing, nowhere)

    return asyncio.create_task(one())


def test_few_begin_in_one_turn_in_their_order() -> None:
    async def scenario(app: Begun, paced: Paced) -> None:
        await asyncio.gather(*[ask(paced, number) for number in range(50)])

    found = in_a_loop(scenario).found
    assert [number for _, number in found] == list(range(50))
    each = [turn for turn, _ in found]
    assert max(each.count(turn) for turn in each) == 4
    assert each[-1] - each[0] <= 50 // 4 + 1  # and none of the turns is wasted


def test_late_comers_do_not_overtake() -> None:
    async def scenario(app: Begun, paced: Paced) -> None:
        early = [ask(paced, number) for number in range(20)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        late = [ask(paced, number) for number in range(20, 30)]
        await asyncio.gather(*early, *late)

    assert [number for _, number in in_a_loop(scenario).found] == list(range(30))


def test_those_that_give_up_take_no_turn() -> None:
    async def scenario(app: Begun, paced: Paced) -> None:
        tasks = [ask(paced, number) for number in range(30)]
        await asyncio.sleep(0)
        for task in tasks[10:20]:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    found = in_a_loop(scenario).found
    assert [number for _, number in found] == [*range(10), *range(20, 30)]
    assert found[-1][0] - found[0][0] <= 20 // 4 + 1


def test_at_the_boundary_requests_wait_and_nothing_else() -> None:
    http = {"method": "GET", "path": "/", "headers": [(b"host", b"here")]}
    app = Begun()

    async def main() -> None:
        boundary = Boundary(
            app, Metrics(CollectorRegistry()), "127.0.0.1", ("here",), lambda: False
        )
        counting = asyncio.create_task(app.count())
        await asyncio.sleep(0)
        scopes: list[Scope] = [{"type": "http", "number": n, **http} for n in range(40)]
        scopes.append({"type": "lifespan", "number": 99})
        await asyncio.gather(*[boundary(scope, nothing, nowhere) for scope in scopes])
        counting.cancel()

    asyncio.run(main())
    turns = {number: turn for turn, number in app.found}
    assert turns[99] == turns[0] < turns[39]


def test_an_application_may_run_in_one_loop_after_the_other() -> None:
    app = Begun()
    paced = Paced(app, 2)

    async def main() -> None:
        await paced({"type": "http", "number": 0}, nothing, nowhere)

    for _ in range(5):
        asyncio.run(asyncio.wait_for(main(), 60.0))
    assert len(app.found) == 5
