"""A second scorer of the evaluation protocol, definitions 2.0: short, slow, plain, sharing no line with the product.

Written from the text of the protocol alone. Which sentence is which function:

- matching.best_pairs: "One-to-one, maximum cardinality first, then minimum total cost, over pairs inside the gate
  (inclusive). At equal cost the higher confidence is matched, then the larger minADE: never the order of rows."
- targets.find_targets: "A target is (scene, g, t) where g has P past and T future true frames (t included in the past)
  ... its [the official list's] targets need T future keyframes only."
- targets.live_frames: "t from P-1 to F-1-T (0 to F-1-T for the official list)."
- targets.unconfirmed: "the object, seen in the image, lies more than half inside a DontCare region, outside the image,
  or is at most 25 px high ... the forecast's x and y, the class's median training size, the ego's heading, a bottom
  1.65 m below the camera"; targets.neutral_rows: "A true box that is neutral by the same test is no target."
- displacement.stated: "a sample of less than 1 % of the uniform weight (w < 0.01 / n, n the samples stated for this
  object; dropped once, the rest renormalised) is absent everywhere, in minADE too."
- displacement.numbers: "minADE_k = min_i mean_tau e_i(tau); minFDE_k = min_i e_i(T) ...; MR = min_i e_i(T) > 2 m";
  "sum_a w_a |x_a - y| - 1/2 sum_a sum_b w_a w_b |x_a - x_b|, norm over the flattened T x 2, divided by sqrt(T)".
- displacement.k_curve: "sum_j e_(j) C(n-1-j, k-1) / C(n, k)".
- forecasts.judge_frame: "A van or a sitting person excuses one forecast, matched one-to-one after the evaluated
  objects"; a false forecast is "unmatched, not neutral, in live frames".
- budgets.cuts: "A cut tau keeps the forecasts of confidence >= tau; the rest are taken away and the kept ones matched
  anew in every frame."
- budgets.at_budgets: "cut 0 keeps none, F_j its false count, j* the last cut before F first exceeds B. If all are kept,
  E(B) = E_j*; else E(B) = (1 - l) E_j* + l E_(j*+1) with l = (B - F_j*) / (F_(j*+1) - F_j*)."
- budgets.budgets_of: "B_j = (j / 10) min(n, F_ref), j = 1..10"; "the single budget B = F_ref"; "N = 20, 40 and STP's
  own number for `all`, STP's own for the subsets".
- shown.fixed_error: "c-GOSPA over forecasts of confidence >= 0.5, min(minADE_k, c) or c per target plus c/2 per false
  forecast in live frames, per target"; "malformed counts as a false forecast of its class (of the largest c if that is
  unreadable)"; "where the truth holds targets only the false term is c/2 per forecast beyond 40 in the frame".
- shown.brier, false_per_frame, planning_aware, epa, ap_f: the sentences with these names.
- events.own_events: "Three kinds, each a list of (scene, object, frame, old id, new id)"; "own_* are events of the best
  hypothesis against its parent"; "Frames in which an object is neutral or missing from the truth count as absent".
- statistics.units_of: "recordings cut into blocks of at most 20 s ... a nuScenes, WILDTRACK or simulated scene is one
  unit"; sign_flip: "exact sign-flip test over units (exact up to 14 units, 10 000 draws beyond)"; studentised:
  "Intervals on the page are studentised ... Bootstrap over units, those without targets included where they carry a
  cost (2000 resamples, fixed seed, same resamples for all agents)"; why_unranked: "A subset ranks only with at least 20
  effective objects, 6 effective units and no unit above 25 % of the weight"; guarded: "an event subset ranks only
  agents whose "all" (point estimate) is not above that of STP, nor of their own `ends` STP".
- scorer.compare: "d_u = sum over unit u of w (e_A - e_B), averaged over budgets and seeds; ... rank is 1 + the number
  of agents significantly better (p < .05)"; Paired.gap: "G = (E_STP - E_agent) / (E_STP - E_GT) ... null unless
  E_STP - E_GT is significantly above 0"; its own_ends: "Both ends use the agent's own predictor and presence
  model where the submission says how to build them ... The gap between the kinematic ends stands beside it".
- Where the text is ambiguous, the docstring of the function says "Reading:".
"""
