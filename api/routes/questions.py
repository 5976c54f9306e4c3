"""The questions of machine access over HTTP; `rotorid mcp` answers the same ones to assistants."""

import inspect
from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Depends

from api import problems
from api.machine.tools import QUESTIONS, Tools, UnclearError, UnknownError
from api.problems import ProblemError
from api.web.dependencies import Owner, PartsOf

router = APIRouter(prefix="/questions", tags=["questions"], responses=problems.RESPONSES)


def _tools(parts: PartsOf, owner: Owner) -> Tools:
    return Tools(parts.database, parts.objects, owner, parts.desk.ask, parts.folder.folder)


def _endpoint(question: Callable[..., object]) -> Callable[..., object]:
    """Return a question as FastAPI takes it: of the same name, arguments and answer."""

    def answer(tools: Tools, **asked: Any) -> object:
        try:
            return question(tools, **asked)
        except UnknownError as error:
            detail = f"{str(error)[:1].upper()}{str(error)[1:]}."
            if isinstance(error, UnclearError):
                raise ProblemError.of("not-possible", detail) from error
            raise ProblemError.missing(detail) from error

    own = inspect.signature(question)
    tools = inspect.Parameter("tools", inspect.Parameter.KEYWORD_ONLY, annotation=Annotated[Tools, Depends(_tools)])
    asked = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in list(own.parameters.values())[1:]]
    answer.__signature__ = own.replace(parameters=[tools, *asked])  # type: ignore[attr-defined]
    answer.__name__, answer.__doc__ = question.__name__, question.__doc__
    return answer


for _question, (_path, _summary) in QUESTIONS.items():
    router.get(_path, summary=_summary)(_endpoint(_question))
