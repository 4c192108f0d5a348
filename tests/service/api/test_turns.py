"""Requests that are ready at the same moment begin a few at a time, in their order."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from starlette.types import Message, Receive, Scope, Send

from vibroimpact_service.api.turns import Turns


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


def in_a_loop(scenario: Callable[[Begun, Turns], Awaitable[None]], at_once: int = 4) -> Begun:
    app = Begun()

    async def main() -> None:
        counting = asyncio.create_task(app.count())
        await asyncio.sleep(0)
        await scenario(app, Turns(app, at_once))
        counting.cancel()

    asyncio.run(main())
    return app


def ask(turns: Turns, number: int, kind: str = "http") -> asyncio.Task[None]:
    async def one() -> None:
        await turns({"type": kind, "number": number}, nothing, nowhere)

    return asyncio.create_task(one())


def test_few_begin_in_one_turn_in_their_order() -> None:
    async def scenario(app: Begun, turns: Turns) -> None:
        await asyncio.gather(*[ask(turns, number) for number in range(50)])

    found = in_a_loop(scenario).found
    assert [number for _, number in found] == list(range(50))
    each = [turn for turn, _ in found]
    assert max(each.count(turn) for turn in each) == 4
    assert each[-1] - each[0] <= 50 // 4 + 1  # and none of the turns is wasted


def test_late_comers_do_not_overtake() -> None:
    async def scenario(app: Begun, turns: Turns) -> None:
        early = [ask(turns, number) for number in range(20)]
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        late = [ask(turns, number) for number in range(20, 30)]
        await asyncio.gather(*early, *late)

    assert [number for _, number in in_a_loop(scenario).found] == list(range(30))


def test_those_that_give_up_take_no_turn() -> None:
    async def scenario(app: Begun, turns: Turns) -> None:
        tasks = [ask(turns, number) for number in range(30)]
        await asyncio.sleep(0)
        for task in tasks[10:20]:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    found = in_a_loop(scenario).found
    assert [number for _, number in found] == [*range(10), *range(20, 30)]
    assert found[-1][0] - found[0][0] <= 20 // 4 + 1


def test_what_is_no_request_does_not_wait() -> None:
    async def scenario(app: Begun, turns: Turns) -> None:
        tasks = [ask(turns, number) for number in range(20)]
        await asyncio.gather(ask(turns, 99, "lifespan"), *tasks)

    found = in_a_loop(scenario).found
    assert found.index((found[0][0], 99)) <= 4


def test_an_application_may_run_in_one_loop_after_the_other() -> None:
    app = Begun()
    turns = Turns(app, 2)

    async def main() -> None:
        await turns({"type": "http", "number": 0}, nothing, nowhere)

    for _ in range(5):
        asyncio.run(asyncio.wait_for(main(), 5.0))
    assert len(app.found) == 5
