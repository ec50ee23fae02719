"""The paper's table of people: SORT and Social-LSTM, with re-tracking, with hypotheses, and with both."""

from __future__ import annotations

from ..cards import Card
from ..networks import network_files
from ..running.settings import Setting, setting_of
from ..submission.loader import load_submission

PEOPLE = "pedestrian"
PLAIN, AGAIN, BOTH = "sort_social_lstm", "sort_social_lstm_retracking", "mtp_social_lstm_retracking"


def is_of_people(card: Card) -> bool:
    """Whether nobody but people is forecast."""
    return card.task.classes == (PEOPLE,)


def retracking_settings(card: Card) -> tuple[Setting, ...]:
    """The four rows: plain, re-tracking, hypotheses, both; none where others than people are forecast.

    None either where their network was not trained on this machine.
    """
    if not is_of_people(card) or not network_files(load_submission(PLAIN).networks, card.id, card.weights_of):
        return ()
    both = load_submission(BOTH)
    return (
        setting_of(load_submission(PLAIN), card),
        setting_of(load_submission(AGAIN), card),
        setting_of(both, card, {"retracking": False}),
        setting_of(both, card),
    )
