"""A second scorer of the evaluation protocol, definitions 3.1: short, slow, plain, sharing no line with the product.

Written from the text of the protocol alone. Which sentence is which function:

- matching.best_pairs: "maximum cardinality, then the surest forecasts, then least cost ... then the larger minADE:
  never the order of rows"; tracks are matched without confidences.
- targets.live_frames: "t from P-1 to F-1-T (0 to F-1-T for the official list)"; after_hole, can_exist: "a step longer
  than 1.5 times the card's is a hole. No target's past or future, no event ... crosses one".
- targets.unconfirmed: "more than half inside a DontCare region, outside the image, or is at most 25 px high ... the
  forecast's x and y, the class's median training size, the ego's heading, a bottom 1.65 m below the camera".
- displacement.stated: "a sample of less than 1 % of the uniform weight (w < 0.01 / n, n the samples stated for this
  object; dropped once, the rest renormalised) is absent everywhere, in minADE too."
- displacement.numbers, shown.*: the sentences with the names of these numbers.
- forecasts.judge_frame: "A van or a sitting person excuses one forecast, matched one-to-one after the evaluated
  objects"; a false forecast is "unmatched, not neutral, in live frames".
- budgets.cuts: "A cut tau keeps the forecasts of confidence >= tau; the rest are taken away and the kept ones matched
  anew in every frame"; shares_at: "j* the last cut before F first exceeds B. If all are kept, E(B) = E_j*; else E(B) =
  (1 - l) E_j* + l E_(j*+1) with l = (B - F_j*) / (F_(j*+1) - F_j*)"; budgets_of: "B_j = (j / 10) min(n,
  F_ref n / n_ref)", with the constants of the card.
- parts.absent_cause: "exactly one cause, the first that holds"; parts_at: "predictor g, localisation p - p', history
  p' - g ..., association e - p: signed, summing to e; without references, or where p or g is missing, rest = e."
- events.own_events: "own_* are events of the best hypothesis against its parent"; "Frames in which an object is neutral
  or missing from the truth count as absent".
- statistics.inverted: "The interval of a paired difference is the inverted sign-flip test, so it excludes 0 exactly
  where p < .05"; guarded: "whose `all` is not significantly (p < .05) and by more than 1 % worse than that of STP, nor
  than that of STP with their own predictor, and not by more than 5 % whatever p is."
- scorer.compare: "a rank range [1 + number significantly better, n - number significantly worse] (p < .05)"; Paired:
  gap "null unless E_STP - E_GT is significantly above 0"; Own: "with the agent's own predictor at all three".
- Where the text is ambiguous, the docstring of the function says "Reading:".
"""
