"""Who may look at a page, and who may not."""

from __future__ import annotations

from tests.unit.companion.page.served import WORD, asking, page


async def test_without_a_word_only_names_of_this_host_are_answered() -> None:
    async with page() as (_, server), asking(server) as session:
        for host, status in (("localhost", 200), ("127.0.0.1:1", 200), ("[::1]:9", 200), ("evil.example", 403)):
            assert (await session.get("/state", headers={"Host": host})).status == status


async def test_a_word_opens_the_page_and_leaves_the_address() -> None:
    async with page(token=WORD) as (_, server):
        async with asking(server) as session:
            assert (await session.get("/state")).status == 401
            assert (await session.get("/state?token=wrong-wrong-wrong")).status == 401
            assert (await session.get("/healthz")).status == 200
            answer = await session.get(f"/?token={WORD}")
            assert answer.status == 200 and answer.url.query_string == ""
            assert (await session.get("/state")).status == 200
        async with asking(server) as session:
            assert (await session.get("/metrics", headers={"Authorization": f"Bearer {WORD}"})).status == 200
            assert (await session.get("/metrics", headers={"Authorization": "Bearer wrong"})).status == 401
