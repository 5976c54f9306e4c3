"""``rotorid token``: who may use the web service."""

from typing import Annotated

import typer

from rotorid.cli.exits import SOME_FAILED, fail

tokens = typer.Typer(
    name="token",
    help="Make, list and revoke the tokens of a web service that is not open to all (ROTORID_ACCESS=tokens).",
    no_args_is_help=True,
)


@tokens.command()
def create(
    owner: Annotated[str, typer.Argument(help="Whose token it is; logs belong to their owner, who may have several.")],
    days: Annotated[float | None, typer.Option(min=0.0, help="Days until it expires. Default: never.")] = None,
) -> None:
    """Make a token and print it: it is shown this once, the service keeps only its digest.

    Example: rotorid token create "Ada Lovelace" --days 90
    """
    from api.server import open_tokens

    if not 0 < len(owner.strip()) <= 100:
        raise typer.BadParameter("an owner's name has 1 to 100 characters")
    with open_tokens() as known:
        typer.echo(known.create(owner.strip(), days))


@tokens.command("list")
def list_tokens() -> None:
    """List the tokens: number, owner, when it was made and when it expires.

    Example: rotorid token list
    """
    from api.server import open_tokens

    with open_tokens() as known:
        for token in known.list():
            expires = "never expires" if token.expires is None else f"expires {token.expires:%Y-%m-%d}"
            typer.echo(f"{token.id}  {token.owner}  made {token.created:%Y-%m-%d}  {expires}")


@tokens.command()
def revoke(token: Annotated[str, typer.Argument(help="Its number, as `rotorid token list` shows it.")]) -> None:
    """Make a token worthless, at once.

    Example: rotorid token revoke 3
    """
    from api.server import open_tokens

    with open_tokens() as known:
        if not known.revoke(token):
            fail(f"there is no token with the number {token}; `rotorid token list` shows them", SOME_FAILED)
